"""Prepared problems: what depends only on a robot and its contacts is computed once, and stored with the robot."""
