"""The hybrid-action suite: tasks of the literature in which a choice has parameters of its own."""
