"""Repeats the measurements of the slides and writes them beside the slides' own figures.

Data flows workload → subjects → modes → cells (measure, pictures, embree) → claims, charts →
report → page. `pyvocc reproduce` is the command; it needs the extras "plot" and "progress".
"""
