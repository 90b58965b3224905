"""What decides the motor torques over time: controllers, schedules and pushes."""
