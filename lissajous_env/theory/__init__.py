"""The paper's closed forms, what is measured of a curve, and the design of a formation."""
