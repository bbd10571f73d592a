"""The tables of README.md and docs/, one kind per file: each module has ``build(path, part)``.

``<!-- table: benchmark, from docs/results/benchmark -->`` calls ``build`` of ``benchmark.py`` with that path, and
``<!-- table: paper.table2, from .. -->`` calls ``build`` of ``paper.py`` with ``part="table2"``. A new kind of table is
one new file here and nothing else; many tables need none, because ``measurements`` shows any JSON of its format.
"""
