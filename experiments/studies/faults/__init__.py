"""What a live run does when something fails: `softaim faults`, and the table of docs/faults.md."""
