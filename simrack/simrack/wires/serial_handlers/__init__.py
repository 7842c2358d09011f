"""Protocol handlers that pyserial finds by URL scheme, once this package is in its list."""
