"""Where finished chunks are kept: in memory, in a zarr store, in a netCDF file; written so that nothing is lost."""
