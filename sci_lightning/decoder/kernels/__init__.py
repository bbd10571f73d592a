"""Convolutions computed fast: equal to the plain ones, chosen by what is quickest on this machine."""
