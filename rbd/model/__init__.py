"""Robot files to a checked model; states; terms of the equations of motion. Knows Pinocchio, and no problem or solver."""
