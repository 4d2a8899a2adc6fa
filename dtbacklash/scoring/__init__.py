"""What every score counts with: shares with their intervals, medians with theirs, intervals that hold the truth."""
