"""Joint maximum-likelihood fits of a hypothesis, information criteria, and the gap on held-out pixels."""
