"""Studies: many cases of any machine, in parallel, kept one by one; knows no machine."""
