"""Motions: frames for a page, strips of pictures, live replay."""
