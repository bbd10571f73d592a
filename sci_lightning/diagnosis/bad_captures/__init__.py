"""Captures that do not fit the others: mislabelled, moved or saturated ones are named and left out of a diagnosis."""
