"""Study of breathing lungs with dense landmarks: deep landmarks are estimated from marks near the surface."""
