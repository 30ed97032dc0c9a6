"""From a campaign's results to tables: data frames, statistics, and the forms that tables are written in."""
