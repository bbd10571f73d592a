"""What the commands share: Hydra, the command line, and one clear line when something is wrong.

Only this package and the commands know Hydra."""
