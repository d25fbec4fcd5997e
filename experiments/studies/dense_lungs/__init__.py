"""Dense landmarks of breathing lungs: those deep inside from marks near the hull."""
