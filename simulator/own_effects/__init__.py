"""Effects that users define: their files, and templates for them."""
