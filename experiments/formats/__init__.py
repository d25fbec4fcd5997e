"""Files that people and programs write: scenes, recordings, scenarios, needles, plans, tables; all checked.

What may enter: another file format. Outputs are written whole or not at all (`outputs.py`).
"""
