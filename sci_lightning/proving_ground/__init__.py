"""The proving ground: hide effects in the virtual camera, diagnose its captures, and count how often that goes right.

cases = plan(suites=("single", "nothing"), seeds=1, size=(64, 64))
record = attempt(cases[0])                      # one diagnosis
rows, shortfalls = sum_up([record])             # the table
"""
