"""Proof: recordings with something concealed in them, and blind scoring of what the diagnosis says about them."""
