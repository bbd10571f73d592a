"""The search for missing effects: screening, competition, pruning, and what is left without a name."""
