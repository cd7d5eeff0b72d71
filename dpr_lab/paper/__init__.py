"""The published experiment repeated: tables, search and figures, compared with the printed ones."""
