"""Where in a frame the marks are: coloured regions, their selection, lookalikes."""
