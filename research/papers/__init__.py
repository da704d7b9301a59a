"""The figures of four papers, rebuilt from the repository: ``python -m research.papers PAPER --out DIR``.

Each paper has a folder, and all folders have the same modules: ``study`` plays the runs, ``numbers`` estimates the
summary, ``pictures`` and ``files`` write the figures, ``table`` and ``claims`` make the tables of the page.
"""
