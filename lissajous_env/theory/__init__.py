"""The paper's closed forms, numerical measures of a curve, and the design of a formation."""
