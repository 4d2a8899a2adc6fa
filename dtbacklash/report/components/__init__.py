"""What all pages share: style, numbers, intervals, tables, the template engine."""
