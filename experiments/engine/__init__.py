"""Runs of studies by the thousand: on processes of this machine or on a cluster, kept as they finish.

What may enter: how runs are spread, repeated and kept. What a run does belongs to who calls. Dask and pyarrow, the
extra `cluster`, are imported where they are used, so that runs in the own process need neither.
"""
