"""The proving ground: hide effects in the virtual camera, diagnose its captures, and count how often that goes right.

Every case is independent. :func:`~.plan.plan` lists cases, :func:`~.trial.run_trial` diagnoses one, the
:mod:`~sci_lightning.studies.engine` keeps the records, and :func:`~.summary.summarise` counts the outcomes::

    cases, records = plan(suites=("single", "nothing"), seeds=1, size=(64, 64)), Records(Path("PROOF/cases"), Outcome)
    ended = list(run_cases(run_trial, records.missing(cases), records, workers=2))
    rows = summarise(records.read())
"""
