"""Behaviour of a live run during faults: `softaim faults`, and the list of docs/faults.md."""
