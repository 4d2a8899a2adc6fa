"""One engine of inference: a Kalman predictor with laws inside, and one comparison of all that a rig may lack."""
