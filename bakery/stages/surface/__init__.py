"""Stage `surface`: light that a plane layer of the medium sends back and lets through."""
