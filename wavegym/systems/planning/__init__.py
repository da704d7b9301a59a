"""Systems in which a choice has a delayed cost: one of the papers' loops and an honest resource each."""
