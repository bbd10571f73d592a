"""The paper's tables: what runs found, beside what the paper prints."""
