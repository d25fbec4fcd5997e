"""What a live run does when something fails: `softaim faults`, and the list of docs/faults.md."""
