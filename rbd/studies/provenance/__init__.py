"""What a study is of, and what computed it: hashes of values and functions, versions, machine."""
