"""What a study keeps of a result: variables with dimensions, units and labels, by the type of the result."""
