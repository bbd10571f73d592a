"""Networks once more, written down as plainly as possible: functions of a state dict with published keys."""
