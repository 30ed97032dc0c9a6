"""``report.html``: a campaign on one page that needs no network, with a player of its recorded trials."""
