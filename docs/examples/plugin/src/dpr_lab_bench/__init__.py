"""One row of each other table, a module each: a table loads the module of a plugin while it is made."""
