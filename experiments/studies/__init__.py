"""Studies, one for each published table or figure.

A new study belongs here.
"""

# Nothing is imported here: each study is run as a module.
