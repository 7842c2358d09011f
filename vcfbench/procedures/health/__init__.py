"""Health: characteristics that K_Vc depends on, measured without a table, then and now."""
