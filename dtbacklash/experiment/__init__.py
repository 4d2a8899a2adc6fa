"""One closed-loop experiment: its signals, its compiled loop, its run, its metrics."""
