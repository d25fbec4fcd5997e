"""What each mechanism of the filter is worth: runs with one of them turned off; `__main__` has the command."""
