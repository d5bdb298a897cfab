"""What everything stands in: model packages, scene files, shapes with exact signed distance."""
