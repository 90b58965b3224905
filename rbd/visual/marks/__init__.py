"""What is drawn around a robot: forces, cones, patches, regions, footprints, as coloured shapes."""
