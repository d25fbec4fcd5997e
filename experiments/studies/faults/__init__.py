"""Study of live runs with faults, which `softaim faults` does and docs/faults.md describes."""
