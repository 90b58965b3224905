"""What notebooks show of records: a result, tables with units, a folded proof; of scenes and motions, the page inline."""
