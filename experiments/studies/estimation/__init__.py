"""The estimation study: seeded runs by the hundred on the phantom, and the page that they make."""
