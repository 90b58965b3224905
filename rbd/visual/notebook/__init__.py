"""What notebooks show of records: a result, tables with units, a folded certificate; of scenes and motions, the page inline."""
