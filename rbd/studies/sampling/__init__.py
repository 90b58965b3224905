"""The samples of a study: grids, draws, tables and their products, each a set of named arguments."""
