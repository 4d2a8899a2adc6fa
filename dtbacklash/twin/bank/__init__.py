"""What has changed on the machine: novelty indexes of its subsystems, and a bank of hypotheses for one buffer."""
