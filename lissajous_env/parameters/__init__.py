"""What a scenario is made of, with every field's meaning, unit and range; and the scenarios that have names."""
