"""The report of a diagnosis: verdict, sentences, pictures and files."""
