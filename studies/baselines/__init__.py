"""What enters the benchmark beside the diagnosis: one adapter a file, each over a well-kept library."""
