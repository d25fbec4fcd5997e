"""Reads, checks and writes files: scenes, recordings, scenarios, needles, plans, tables.

Code for a new format belongs here. Files are written with the functions of `outputs.py`.
"""
