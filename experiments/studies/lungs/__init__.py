"""Study of breathing lungs: inner landmarks are estimated from landmarks on the hull; `__main__` has the command."""
