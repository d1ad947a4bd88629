"""Reports: figures with their uncertainty and the paper's, pages and exports."""
