"""Study of the pace of a live run, measured on the run itself with connected clients."""
