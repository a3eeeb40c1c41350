"""What a person reads of a run: outcomes, tables, pictures. Everything here reads recordings."""
