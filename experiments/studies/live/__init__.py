"""How a live run keeps up, measured on the run itself with clients that watch it."""
