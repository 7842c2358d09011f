"""All procedures of one gyroscope in one session, and their one data sheet."""
