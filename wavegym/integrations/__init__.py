"""wavegym inside other frameworks: a package for each, which only its own users import."""
