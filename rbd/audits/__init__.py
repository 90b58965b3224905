"""Audits of contact forces: those of other programs, and a public bench of friction problems."""
