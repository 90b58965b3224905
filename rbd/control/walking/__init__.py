"""Walking: footsteps and gaits, the plan of the centre of mass over them, and the controller that walks."""
