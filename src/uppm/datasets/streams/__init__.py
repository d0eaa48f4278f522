"""Cameras that run: each gives frames as they come, for `uppm.LiveMapper`."""
