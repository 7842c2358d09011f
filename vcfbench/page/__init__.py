"""The page in a browser: a run while it goes, and the records of a station. Needs the extra `page`."""
