"""What a campaign or a trial looks like: tables, figures, pictures and clips."""
