"""Environments of Gymnasium over many worlds (extra `envs`)."""
