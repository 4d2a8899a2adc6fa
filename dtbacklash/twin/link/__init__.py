"""Requests and answers between controller and twin: their delay, and a twin in this process or in its own."""
