"""What a diagnosis works on: records of recordings, the cut rig with its pull, first states, the noise floor."""
