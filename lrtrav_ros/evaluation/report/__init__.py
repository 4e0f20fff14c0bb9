"""Presentation of a finished evaluation: tables, charts, pictures and the HTML page."""
