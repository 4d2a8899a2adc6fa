"""The digital twin: it estimates the gap from measurements, and is trusted as far as these allow."""
