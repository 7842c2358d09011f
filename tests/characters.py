"""Characters that texts are drawn from: all that UTF-8 has, which Hypothesis by itself takes seconds to find out."""

from hypothesis import strategies as st

CHARACTERS = st.characters(exclude_categories=["Cs"])
