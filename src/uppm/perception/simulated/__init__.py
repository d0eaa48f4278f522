"""Simulated perception: ground-truth instances seen through a noise model (docs/simulated.md)."""
