"""What a run leaves behind: checkpoints, metrics, and what it takes to resume."""
