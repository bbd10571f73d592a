"""Joint maximum-likelihood fits of a hypothesis, and how well they predict held-out pixels."""
