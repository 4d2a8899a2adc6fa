"""What a diagnosis says and writes: findings, sentences, figures' data, files."""
