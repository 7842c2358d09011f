"""Languages of rate tables, a plug-in of vcfbench: those in TOML, Zaber's, Newport's and ATL.

The project finds them as it finds those of any other package: by their rows (:mod:`vcfbench_tables.languages`), entry
points in ``vcfbench.models``, and what reads a profile (:mod:`vcfbench_tables.profile`), one in
``vcfbench.table_profiles``. None of them has been tried on hardware.
"""
