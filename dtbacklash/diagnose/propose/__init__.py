"""What could be missing: signatures, wave numbers and delays that the residual asks for."""
