"""Study of live runs with faults, for `softaim faults`; docs/faults.md has the results."""
