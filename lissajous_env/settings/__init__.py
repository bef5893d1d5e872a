"""Parts of a scenario: their fields with rules and units, the checks of such fields, and formulas of parameters."""
