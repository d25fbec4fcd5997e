"""Study of breathing lungs with dense landmarks: deep ones are estimated from marks near the hull."""
