"""What datasets must look like: declared in `data_schema/`, checked and converted at every border."""
