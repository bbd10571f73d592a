"""Questions that take many runs: tables, proving ground, mismatch, benchmark, design of masks."""
