"""Studies that map a sequence many times: ablations and curves over noise (docs/simulated.md)."""
