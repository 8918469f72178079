"""The site that `make docs` builds: the repository's own pages, and what they take from the code."""
