"""Training all rows of the paper's tables: a queue that survives interruptions and keeps what is finished."""
