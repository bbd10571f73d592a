"""From configurations to objects: what a file may say, which classes it may name, and how arguments are checked."""
