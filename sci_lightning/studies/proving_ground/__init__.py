"""The proving ground: hide effects in the virtual camera, diagnose its captures, and count how often that goes right.

Every case is independent. :func:`~.plan.plan` lists cases, :func:`~.trial.run_trial` diagnoses one and returns a record
of plain data, :func:`~.outcome.parse_record` reads a record, and :func:`~.summary.summarise` counts the outcomes::

    cases = plan(suites=("single", "nothing"), seeds=1, size=(64, 64))
    records = [run_trial(case) for case in cases]
    rows = summarise([parse_record(record) for record in records])
"""
