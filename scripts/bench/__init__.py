"""The benchmarks: `python scripts/bench PART`."""
