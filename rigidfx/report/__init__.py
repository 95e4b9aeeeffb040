"""Reports of a run: steps, bodies, events, probes, balance of energy."""
