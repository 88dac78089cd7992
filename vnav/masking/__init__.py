"""Which pixels show moving things; the default keeps everything."""
